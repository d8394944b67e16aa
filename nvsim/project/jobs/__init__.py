"""The jobs of a project: orders, the queue, and the record of commands in terminals."""
