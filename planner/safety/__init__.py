"""Safety: test each plan against the map, and keep a way to stop at hand."""
