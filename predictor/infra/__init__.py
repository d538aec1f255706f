"""Infrastructure: command lines, worker processes, files that are written whole, and parsers."""
