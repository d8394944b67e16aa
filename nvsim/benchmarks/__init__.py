"""What measures cost: one file a subject, run by `nvsim bench`. Nothing but the commands depends on it."""
