"""Training kit of Flashmat: materials in, a quantised model file for the Rust engine out."""

CLASSES = ("fabric", "ground", "leather", "metal", "stone-diff", "stone-spec", "polymer", "wood")
METAL = CLASSES.index("metal")
