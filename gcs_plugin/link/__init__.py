"""Connect to vehicles: transports, the listener, signing, and the plugin's own messages."""
