"""The time loop of a scene, what it writes, and how it adapts its step."""
