"""What comes back: data, and the rule of the verdict."""
