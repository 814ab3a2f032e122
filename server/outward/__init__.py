"""Messages of the service to other systems: states of machines, results of jobs, alarms. Nothing comes in this way.

- :mod:`server.outward.outward_message`: the one typed value that all of them are, and its schema
- :mod:`server.outward.outward_stream`: reads what is to be said once, and gives it to all that say it
- :mod:`server.outward.webhook_desk`: signed requests to addresses of the administrator's list, tried again for a day
- :mod:`server.outward.mqtt_publisher`, :mod:`server.outward.opcua_server`: the same for a broker and for OPC UA clients
"""
