"""The command line: one thin function a command, imports inside. Exit 0 on success, 2 with one message on a user's error."""

from __future__ import annotations

from fmucorrect.cli import assessing, contact, discovery, drafting, running, training, wrapping
from fmucorrect.cli.group import UserError, main

__all__ = ["UserError", "main"]

for command in (running.demo, running.run, running.replay, running.inspect):
    main.add_command(command)
main.add_command(drafting.new)
main.add_command(wrapping.wrap)
main.add_command(discovery.discover)
main.add_command(assessing.assess)
main.add_command(contact.contact)
for command in (training.train, training.compare, training.diagnose):
    main.add_command(command)
