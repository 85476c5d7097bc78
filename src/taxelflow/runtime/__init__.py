"""How kernels, processes and URLs work, whatever the stage: compile, run beside the stream, adopt, address."""
