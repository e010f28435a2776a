"""The networks of the learned start, and the parts they are built of."""
