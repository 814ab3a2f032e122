"""Child processes, which never outlive this one, and heavy work in threads of its own."""
