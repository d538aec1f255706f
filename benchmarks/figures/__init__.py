"""Figures of saved runs."""
