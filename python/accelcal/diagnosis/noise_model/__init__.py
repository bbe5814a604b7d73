"""What effects that act on noise amount to, and what they gain on held-out data."""
