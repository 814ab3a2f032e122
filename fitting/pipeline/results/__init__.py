"""What stages hand on, and what the report and the terminal say of it."""
