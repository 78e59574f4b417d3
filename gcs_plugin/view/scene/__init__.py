"""The 3D scene: aircraft, route, surroundings, camera."""
