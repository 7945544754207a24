"""Many runs: each in its own process, each to a row."""

from pathlib import Path

from grs_agents.runs import Job, figures_of_run, markdown_table, run_jobs, summarise_runs, terminal_table


def test_good_and_bad_jobs_side_by_side(tmp_path: Path, small_scene: Path) -> None:
    jobs = [Job("good", small_scene, tmp_path / "good"), Job("bad", tmp_path / "nowhere", tmp_path / "bad")]
    told: list[str] = []
    done = run_jobs(jobs, 2, 200, lambda one: told.append(one.job.name))
    assert [one.job.name for one in done] == ["good", "bad"] and sorted(told) == ["bad", "good"]
    assert [one.exit_status for one in done] == [0, 2], done
    assert "nowhere" in done[1].error
    rows = [figures_of_run(one) for one in done]
    assert [one["status"] for one in rows] == ["accepted", "failed"]
    figures = summarise_runs(done, rows)
    assert (figures["runs"], figures["verdicts"], figures["accepted"]) == (2, 1, 1)
    assert markdown_table(list(rows[0]), rows).count("\n") == 4
    assert terminal_table("t", list(rows[0]), rows).row_count == 2

    again = run_jobs(jobs[:1], 1, 200)  # an ended run is not made again
    assert again[0].record == done[0].record


def test_a_job_that_takes_too_long_is_killed(tmp_path: Path, small_scene: Path) -> None:
    done = run_jobs([Job("slow", small_scene, tmp_path / "slow")], 1, 0.5)
    assert done[0].exit_status is None
    assert "killed" in done[0].error
    assert figures_of_run(done[0])["status"] in ("killed", "running")
