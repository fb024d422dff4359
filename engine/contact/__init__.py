"""Contact of thin structures with obstacles."""
