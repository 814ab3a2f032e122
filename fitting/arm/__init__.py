"""The arm: geometry, linkages, dynamics, base parameters."""
