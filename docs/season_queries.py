"""A season asked with duckdb alone: python docs/season_queries.py STORE

Every unknown figure is null, so that sums and least values are of what is known.
"""

import sys

import duckdb

QUESTIONS = {
    "aircraft, the one with the least margin first": """
        select aircraft, count(*) as flights, round(sum(flying_s) / 3600, 1) as hours,
               round(sum(coalesce(hectares, hectares_at_least)), 1) as hectares,
               round(min(worst_margin), 3) as worst_margin,
               count(*) filter (verdict = 'critical') as too_heavy,
               count(*) filter (verdict = 'unknown') as no_verdict
        from flights group by aircraft order by worst_margin""",
    "why flights have no verdict": """
        select reason_kinds, count(*) as flights from flights
        where verdict = 'unknown' group by all order by flights desc""",
    "the ten flights with most time above the limit": """
        select aircraft, log_name, make_timestamp((started_unix_s * 1e6)::bigint) as started,
               round(rows_above_limit_s) as seconds, worst_rotor, doing_kinds
        from flights where rows_above_limit_s > 0 order by rows_above_limit_s desc limit 10""",
    "measured over predicted speed of rotor 1, by month": """
        select aircraft, month, round(median(speed_ratio[1]), 4) as ratio, count(*) as flights
        from flights where verdict <> 'unknown' group by all order by all""",
    "seconds of each aircraft with a rotor at 60 % or more, from the rows": """
        select aircraft, count(*) * 0.1 as seconds from rows
        where flying and least(margin_1, margin_2, margin_3, margin_4) < 0.4
        group by aircraft order by seconds desc""",
}


def main(store: str) -> None:
    season = duckdb.connect()
    for table in ("flights", "rows"):
        files = f"{store}/{table}/**/*.parquet"
        season.execute(
            f"create view {table} as select * from "
            f"read_parquet('{files}', hive_partitioning = true, hive_types_autocast = false)"
        )
    for title, question in QUESTIONS.items():
        print(f"\n{title}")
        answer = season.execute(question)
        assert answer is not None
        names = [column[0] for column in answer.description or []]
        print("  " + " | ".join(names))
        for row in answer.fetchall():
            print("  " + " | ".join("unknown" if cell is None else str(cell) for cell in row))


if __name__ == "__main__":
    main(sys.argv[1])
