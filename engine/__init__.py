"""The simulation engine: thin structures, liquids, and the loop that runs a scene."""
