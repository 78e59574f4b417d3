"""Parts that several commands share: their inputs, options, plans and printing."""
