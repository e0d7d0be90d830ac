"""Figures of a session: floor, shrink, where the gap lies."""
