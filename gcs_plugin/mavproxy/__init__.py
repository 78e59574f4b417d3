"""What the MAVProxy module runs beside MAVProxy: its worker and its 3D view."""
