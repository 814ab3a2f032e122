"""CANopen: a bus that we lead, or one that another master leads.

- :mod:`~daq.drivers.canopen.driver`: a bus that we lead: SYNC out, TPDOs in, nodes that come and go
- :mod:`~daq.drivers.canopen.leadership`: who leads the bus, and whether anything may be sent
- :mod:`~daq.drivers.canopen.look`: the TPDOs of a cycle, at once where nothing is out of the ordinary
- :mod:`~daq.drivers.canopen.care`: SYNC and NMT commands; what is done about a node, in its keeper's thread
- :mod:`~daq.drivers.canopen.node`, ``tpdo``: what is known of a node, and what is noticed about it in each cycle
- :mod:`~daq.drivers.canopen.link`: frames by their COB-ID, SYNC, NMT, SDO
- :mod:`~daq.drivers.canopen.commissioning`, ``mapping``, ``profiles``: how nodes are set up and put back
- :mod:`~daq.drivers.canopen.listening`, ``eds``: a bus that another master leads, and where its objects are
"""
