"""The residual loop: is anything left above the noise, what physical effect is it, does adding it help."""
