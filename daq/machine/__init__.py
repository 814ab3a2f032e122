"""The machine file: joints, linkages, channels and buses, their checks, and the files of devices it names."""
