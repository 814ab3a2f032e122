"""The page in a browser like a tablet's: how soon it is there, how smoothly it draws, what each view looks like."""
