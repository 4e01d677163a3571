"""What `import lagsim` shows, one file for each thing that it does."""
