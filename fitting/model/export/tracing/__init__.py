"""The model as a graph of operations: traced once, then printed in any language."""
