"""What a vehicle is set to: values of its parameters, and what they mean for its outputs."""
