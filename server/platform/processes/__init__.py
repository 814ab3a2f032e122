"""Child processes, which never outlive this one, heavy work in threads of its own, and errands that are tried again."""
