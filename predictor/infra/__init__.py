"""Infrastructure: command lines, worker processes, atomic files, resumable folders, parsers."""
