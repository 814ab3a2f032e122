"""The command line; a command's module is imported when the command is used.

- :mod:`server.commands.command_line`: the ``hilfit`` command, which mounts those of all packages
- :mod:`server.commands.serve_command`, :mod:`server.commands.operate_commands`,
  :mod:`server.commands.demo_command`, :mod:`server.commands.doctor_command`: commands of the service
- :mod:`server.commands.openapi_file`: writes ``docs/openapi.json``, for development
"""
