"""The light, from cues to a fit and how sure it is."""
