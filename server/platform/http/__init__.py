"""Layers between the socket and the routes: limits, problem documents, kept answers, the page's files."""
