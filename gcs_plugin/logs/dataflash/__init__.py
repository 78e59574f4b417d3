"""ArduPilot's DataFlash logs, binary and as text."""
