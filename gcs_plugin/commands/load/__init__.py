"""Commands on the load that an aircraft may carry."""
