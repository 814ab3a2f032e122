"""Workers on other hosts: network namespaces that share no folder, PostgreSQL with a password, an S3 server."""
