"""What a term is worth elsewhere: held-out blocks, `validate`, unloaded recordings, replicas, noisier rows."""
