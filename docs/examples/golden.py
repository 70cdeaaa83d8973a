"""Compare two sessions: what does the client say that it did not say before."""

from dissect.testing.golden import diff_sessions, read_session

before = read_session("captures/golden/blocks.s7.txt")
after = read_session("captures/blocks-python.pcapng")
for difference in diff_sessions(before, after):
    print(difference.text)

# Output:
# connection 1, TSAPs: was TSAP 01.00 (PG) → 01.02 (PG, rack 0 slot 2), is TSAP 01.00 (PG) → 01.01 (PG, rack 0 slot 1)
# connection 1, end: was fin by the client, is disconnect by the client (DR from the client: reason not specified)
# transaction 3, block functions: list blocks of type DB: answer, userdata parameters, data_unit_ref: was 1, is 0
# transaction 3, block functions: list blocks of type DB: answer, block DB, flags: was 0x22, is 0x0
# transaction 3, block functions: list blocks of type DB: answer, block DB, language: was DB (0x05), is undefined (0x00)
# transaction 3, block functions: list blocks of type DB: answer, block DB, flags: was 0x22, is 0x0
# transaction 3, block functions: list blocks of type DB: answer, block DB, language: was DB (0x05), is undefined (0x00)
# transaction 3, block functions: list blocks of type DB: answer, block DB, flags: was 0x22, is 0x0
# …
