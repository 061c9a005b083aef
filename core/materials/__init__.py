"""What surfaces are made of, under lights that are known."""
