"""Decode SCD inside S7 traffic, with a dictionary and a file that says where it travels."""

import dissect

events = dissect.open(
    "captures/scd/plant.pcapng", scd="captures/scd/plant.toml", bind="captures/scd/plant.bind.toml", pdus=False
)
for event in events:
    if isinstance(event, dissect.Transaction):
        for message in event.scd:
            print(message.frame, message.subject, [(row.name, row.physical, row.unit) for row in message.values])

# Output:
# 1 PDO T1 Состояние 1 [('Слово состояния 1', 567, ''), ('Расход 1', 1200, ''), ('Режим 1', 8, '')]
# 2 PDO T65 Состояние 2 [('Слово состояния 2', 567, ''), ('Расход 2', 900, ''), ('Режим 2', 8, '')]
# 2 PDO T2 Насос и давление 1 [('Насос 1.run', True, ''), ('Насос 1.fault', False, ''), ('Давление 1', 1374.0, 'кПа'), ('Насос 1.speed', 1480, 'об/мин')]
# 3 PDO T1 Состояние 1 [('Слово состояния 1', 567, ''), ('Расход 1', 1193, ''), ('Режим 1', 8, '')]
# 4 PDO R1 Команда 1 [('Насос 1.run', True, ''), ('Насос 1.speed', 1500, 'об/мин')]
# 5 PDO T1 Состояние 1 [('Слово состояния 1', 567, ''), ('Расход 1', 1186, ''), ('Режим 1', 8, '')]
# 6 PDO T1 Состояние 1 [('Слово состояния 1', 567, ''), ('Расход 1', 1179, ''), ('Режим 1', 8, '')]
# 7 PDO T1 Состояние 1 [('Слово состояния 1', 567, ''), ('Расход 1', 1172, ''), ('Режим 1', 8, '')]
# …
