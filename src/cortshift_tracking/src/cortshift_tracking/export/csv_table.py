"""One line for each valid point. Metres."""
import io

import numpy as np

from cortshift_tracking.durable import write_durably

HEADER = 'row,column,x_m,y_m,z_m,dx_m,dy_m,dz_m,confidence,red,green,blue,space'


def write(path, field, axes):
    rows, columns = np.nonzero(field.valid)
    numbers = np.column_stack([rows, columns, field.start[rows, columns], field.displacement[rows, columns],
                               field.confidence[rows, columns], field.colour[rows, columns]])
    text = io.StringIO()
    # Nine digits give a float32 back.
    np.savetxt(text, numbers, ['%d'] * 2 + ['%.9g'] * 7 + ['%d'] * 3, ',', header=HEADER, comments='')
    lines = text.getvalue().splitlines()
    write_durably(path, '\n'.join([lines[0]] + [f'{line},{axes}' for line in lines[1:]]) + '\n')
