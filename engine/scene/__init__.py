"""What a scene may say, and how it becomes models and states."""
