"""What a run leaves behind: one file per thing written, each whole or not at all."""
