"""One line for each valid point. Metres.

Each line ends with what holds for all: the axes of pMR space, and, as far as it is known, what the field was made with and its
warnings. So no part of a table is without them.
"""
import csv
import io

import numpy as np

from cortshift_tracking.durable import write_durably

HEADER = 'row,column,x_m,y_m,z_m,dx_m,dy_m,dz_m,confidence,red,green,blue'


def write(path, field, axes):
    rows, columns = np.nonzero(field.valid)
    numbers = np.column_stack([rows, columns, field.start[rows, columns], field.displacement[rows, columns],
                               field.confidence[rows, columns], field.colour[rows, columns]])
    header, formats = HEADER, ['%d'] * 2 + ['%.9g'] * 7 + ['%d'] * 3
    if field.uncertainty is not None:
        header, formats = header + ',uncertainty_m', formats + ['%.9g']
        numbers = np.column_stack([numbers, field.uncertainty[rows, columns]])
    text = io.StringIO()
    # Nine digits give a float32 back.
    np.savetxt(text, numbers, formats, ',')
    common = {'space': axes, **field.remarks}
    quoted = io.StringIO()
    csv.writer(quoted, lineterminator='').writerow(common.values())
    write_durably(path, '\n'.join([','.join([header, *common])] + [f'{line},{quoted.getvalue()}' for line in text.getvalue().splitlines()])
                  + '\n')
