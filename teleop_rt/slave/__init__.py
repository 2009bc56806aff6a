"""The slave daemon: sense, decide, act, next to the actuator."""
