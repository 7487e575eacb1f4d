"""Links and joints that a machine file names and its URDF does not have."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from armdesign.errors import MachineFileError, choose
from armdesign.machine.file.schema import MachineSection
from armdesign.machine.parts import pin_sections


def unknown_links(
    section: MachineSection, links: Collection[str], source: str
) -> list[MachineFileError]:
    """A fault for every link that the URDF does not have."""
    return [
        MachineFileError(f"{source}: {path}", f'no link "{link}" in the URDF', choose(link, links))
        for path, link in _links(section)
        if link is not None and link not in links
    ]


def _links(section: MachineSection) -> Iterator[tuple[str, str | None]]:
    """Every link that a machine file names, with its key path."""
    requirements = section.requirements
    for link in requirements.outline:
        yield "requirements.outline", link
    for name, case in section.payload.items():
        yield f"payload.{name}.link", case.link
    yield "tool.link", section.tool.link
    for name, lift in requirements.lift.items():
        yield f"requirements.lift.{name}.link", lift.link
    for name, clearance in requirements.clearance.items():
        yield f"requirements.clearance.{name}.link", clearance.link
    for name, cylinder in section.cylinder.items():
        for key, pin in pin_sections(cylinder).items():
            yield f"cylinder.{name}.{key}.link", pin.link


def unknown_joints(
    section: MachineSection, joints: Collection[str], movable: Collection[str], source: str
) -> list[MachineFileError]:
    """A fault for every motor on a joint that the URDF does not have."""
    named = ((name, motor.joint or name) for name, motor in section.motor.items())
    return [
        MachineFileError(
            f"{source}: motor.{name}.joint",
            f'no joint "{joint}" in the URDF',
            choose(joint, movable),
        )
        for name, joint in named
        if joint not in joints
    ]
