"""The newest lines of the service's log, for whoever has no shell on its computer."""
