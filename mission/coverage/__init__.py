"""A field and a swath in, a route that sprays it out. In plan, geometry is (east, north) in m."""
