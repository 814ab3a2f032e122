"""What a cycle is made of: channels in their places, the frame, the clock that leads, events of devices."""
