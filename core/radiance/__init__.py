"""What lights send, what stands in their way, and what surfaces make of it: the forward model."""
