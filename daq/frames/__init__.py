"""Parts of a cycle: channels in their places, the frame, the clock that leads, events of devices."""
