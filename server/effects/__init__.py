"""The catalogue of physical effects that the loop knows, for reading."""
