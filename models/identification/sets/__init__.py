"""Search over sets of effects: score each on Gram matrices, with nuisances marginalised."""
