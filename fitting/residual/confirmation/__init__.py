"""Confirmation of a term elsewhere: held-out blocks, `validate`, unloaded recordings, replicas, noisier rows."""
