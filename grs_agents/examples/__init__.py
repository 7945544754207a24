"""Scripts of one screen that learn an accepted task: ``python -m grs_agents.examples.NAME RUN``.

They are there to be read and copied; nothing else imports them. What they need beyond GRS stands at their top.
"""
