"""Timing: how long stages and other programs take, and how much gets done."""
