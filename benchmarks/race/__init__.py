"""The race: what drives (`entry`), one drive of it (`race_drive`), and the ranking (`ranking`)."""
