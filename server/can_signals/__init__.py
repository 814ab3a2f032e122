"""DBC files of a machine: the signals that they offer, which channels use them, download and replacement."""
