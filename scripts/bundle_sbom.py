"""The bill of materials of a bundle: CycloneDX JSON, with the SHA-256 and dependencies of each wheel (scripts/bundle.py)."""

from __future__ import annotations

import hashlib
import uuid
from datetime import UTC, datetime

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model import HashAlgorithm, HashType
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.output.json import JsonV1Dot6
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
from packageurl import PackageURL

from scripts.bundle_target import Wheel

#: A licence longer than this is a complete licence text, which is in the wheel.
NAME_LENGTH = 100


def component(wheel: Wheel) -> Component:
    """Return the entry of a wheel; its reference is its package URL."""
    url = PackageURL("pypi", name=wheel.name, version=str(wheel.version), qualifiers={"file_name": wheel.path.name})
    digest = hashlib.sha256(wheel.path.read_bytes()).hexdigest()
    told = str(wheel.metadata["License-Expression"] or wheel.metadata["License"] or "").strip()
    return Component(
        type=ComponentType.LIBRARY,
        name=wheel.name,
        version=str(wheel.version),
        purl=url,
        bom_ref=url.to_string(),
        description=str(wheel.metadata["Summary"] or "") or None,
        hashes=[HashType(alg=HashAlgorithm.SHA_256, content=digest)],
        licenses=[LicenseFactory().make_from_string(told)] if told and len(told) <= NAME_LENGTH else [],
    )


def bill(wheels: list[Wheel], needs: dict[str, set[str]], root: str, when: int) -> str:
    """Return the bill as JSON that its published schema accepts, the same for the same wheels."""
    entries = {wheel.name: component(wheel) for wheel in wheels}
    own = entries.pop(root)
    own.type = ComponentType.APPLICATION
    digests = "".join(sorted(str(next(iter(entry.hashes)).content) for entry in [own, *entries.values()]))
    bom = Bom(components=entries.values(), serial_number=uuid.uuid5(uuid.NAMESPACE_OID, digests))
    bom.metadata.component = own
    bom.metadata.timestamp = datetime.fromtimestamp(when, UTC)
    everyone = {root: own, **entries}
    for name, others in sorted(needs.items()):
        bom.register_dependency(everyone[name], [everyone[other] for other in sorted(others)])
    text: str = JsonV1Dot6(bom).output_as_string(indent=2)
    fault = JsonStrictValidator(SchemaVersion.V1_6).validate_str(text)
    if fault is not None:
        message = f"the bill of materials is not what its schema allows: {fault}"
        raise ValueError(message)
    return text + "\n"
