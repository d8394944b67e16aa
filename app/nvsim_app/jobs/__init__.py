"""Runs commands from the window: the queue of jobs, the events of each job, and queries to the command line. Jobs are
separate processes that continue after the window closes."""
