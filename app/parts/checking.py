"""What is wrong with the graph and what a person should look at next."""

from __future__ import annotations

from app.panels.validation import ValidationPanel
from app.parts.part import Dock, Part, Workspace


class CheckPart(Part):
    ACTIONS = ()

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self.panel = ValidationPanel(workspace.document)

    def docks(self) -> tuple[Dock, ...]:
        return (Dock("validation", "Validation", self.panel, "right", "details"),)
