"""The loop: residual -> missing effect -> added effect -> error before and after."""
