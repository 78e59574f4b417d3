"""The page's server, its token and its checks of requests."""
