"""One module for each format, named after it: ``write(model, path, possible)`` writes a model.

``possible`` is for formats of bodies and motions: where the model has impossible ones, take the nearest that can exist.
What the languages share is :mod:`fitting.model.export.functions`; a format's text is in it, or in ``templates``.
"""
