"""What capture and render both know: the job, its files and their record, its result, and its steps."""
