"""Plan a route that sprays a field with a given swath. Plane geometry is (east, north) in m."""
