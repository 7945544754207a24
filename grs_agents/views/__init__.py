"""Views of a run, made from its events. Import rerun's view from ``grs_agents.views.rerun.rerun_view`` (``RerunView``,
``rebuild_rrd_file``) only on demand: importing rerun is slow."""
