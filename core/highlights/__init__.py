"""Highlights in a photo, from the photo alone (thesis chapter 3)."""
