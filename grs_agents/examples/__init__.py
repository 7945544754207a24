"""Short scripts that learn an accepted task: ``python -m grs_agents.examples.NAME RUN``.

They are to be read and copied; nothing else imports them. Imports at their top show the packages they need beyond GRS.
"""
