"""Running the command line from the window: the queue of jobs, what each has told so far, settings made into arguments.
Jobs are processes that outlive the window; nothing here computes."""
