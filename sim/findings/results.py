"""The results of a run as files for people and for other programs: findings, surfaces and poses."""

from __future__ import annotations

from sim.record.poses import write_poses_json
from sim.record.run_record import RunRecord

from .evidence import Evidence
from .findings import Findings, find
from .surface_files import write_surfaces
from .tables import write_finding_tables


def findings_of(record: RunRecord) -> Findings:
    """The findings of the last map of a run, finished or not."""
    return find(Evidence.of_record(record))


def write_results(record: RunRecord) -> Findings:
    """Write tumours.csv, false_findings.csv, surfaces/ and poses.json to a run's folder, finished or not."""
    findings = findings_of(record)
    write_finding_tables(record.folder, findings)
    write_surfaces(record, findings)
    write_poses_json(record.folder, record.T_world_organ)
    return findings
