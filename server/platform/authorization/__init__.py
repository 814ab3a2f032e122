"""Roles, and the actions that each may take.

- :mod:`server.platform.authorization.principals`: principals, roles, scopes, machine binding
- :mod:`server.platform.authorization.guard`: what routes declare, ``dependencies=[require("operate")]``, and routes
  that check what a request names
- :mod:`server.platform.authorization.named_things`: types of values that name something of a machine
- :mod:`server.platform.authorization.ownership`: to which machine something belongs
"""
