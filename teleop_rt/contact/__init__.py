"""Contact physics: effects, each declared once, and models that are tuples of effects."""
