"""The inside of the sandbox: the zygote, its children, and the tests of a program."""
