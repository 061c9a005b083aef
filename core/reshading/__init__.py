"""The photo lit again."""
