"""What the monitor finds out, as metrics that Prometheus collects and Grafana draws."""
