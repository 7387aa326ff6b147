import sys; sys.path.insert(0,'/work/main/tests')
import learn_scenes as S
from pathlib import Path
p=Path('/tmp/hunt/rec'); p.mkdir(exist_ok=True)
for n in 'abcd': S.record(p/f'{n}.mcap', subject=n, session=n)
d=(p/'b.mcap').read_bytes(); (p/'b_cut.mcap').write_bytes(d[:len(d)*2//3])
