"""The residual loop on recordings: session, kinematics, attribution, long recordings."""
