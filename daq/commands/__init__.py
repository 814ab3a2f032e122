"""The commands of ``hilfit`` that acquire, record, and set machines up."""
