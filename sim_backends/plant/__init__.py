"""The arm: physics, sensors, motions and the controller; a process of its own."""
