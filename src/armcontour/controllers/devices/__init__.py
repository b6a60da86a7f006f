"""Programs that feed a controller: processes of their own, which need only its client library."""
