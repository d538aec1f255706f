"""The report of a run: one page in HTML, with the replay of its drives."""
