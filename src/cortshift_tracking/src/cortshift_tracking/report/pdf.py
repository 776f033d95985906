"""The report as PDF."""
import os
import shutil
import subprocess
import tempfile

from cortshift_tracking.errors import CaseError


def print_pdf(page_path, pdf_path):
    """Print an HTML file to PDF through headless Chromium. Raises CaseError where it is missing or fails."""
    browser = shutil.which('chromium') or shutil.which('chromium-browser') or shutil.which('google-chrome')
    if browser is None:
        raise CaseError('no PDF: chromium is not installed; install it, or ask for the HTML file alone (--no-pdf)')
    with tempfile.TemporaryDirectory() as profile:
        run = subprocess.run([browser, '--headless', '--no-sandbox', '--disable-gpu', f'--user-data-dir={profile}',
                              '--no-pdf-header-footer', f'--print-to-pdf={os.path.abspath(pdf_path)}',
                              'file://' + os.path.abspath(page_path)],
                             stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True, timeout=300, check=False)
    if run.returncode != 0 or not os.path.exists(pdf_path):
        raise CaseError(f'no PDF: chromium failed ({run.stdout.strip()[-300:]}); try again, or --no-pdf')
