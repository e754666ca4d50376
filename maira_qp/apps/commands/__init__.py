"""The verbs of the command line, a file each: a frozen class whose fields are its flags, and `run() -> exit code`."""
