"""Pictures of the state: live in the browser and recorded."""
