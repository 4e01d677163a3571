"""Parts of integration methods: tableaus, step control, projection, the loop."""
