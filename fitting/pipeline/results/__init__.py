"""Results of stages, and their content in the report and on the terminal."""
