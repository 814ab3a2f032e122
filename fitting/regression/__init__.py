"""The one regression behind both stages and the loop: rows, drive, priors, noise, what can be identified."""
