"""Whether goals hold: relations between objects, the published score and the strict one."""
