"""Selection: from the base model to one that is adequate, effect by effect."""
