"""The laboratory: measurements that anyone can run again."""
