"""What is read off a photo before any light is known: samples, their noise, segments of one colour."""
