! Rossler's system, a = b = 0.2, as a periodic orbit for AUTO-07p (IPS = 2).
!
!   x' = -y - z,  y' = x + 0.2 y,  z' = 0.2 + z (x - c)
!
! PAR: 1 c, 11 period.
      SUBROUTINE FUNC(NDIM,U,ICP,PAR,IJAC,F,DFDU,DFDP)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM, ICP(*), IJAC
      DOUBLE PRECISION, INTENT(IN) :: U(NDIM), PAR(*)
      DOUBLE PRECISION, INTENT(OUT) :: F(NDIM)
      DOUBLE PRECISION, INTENT(INOUT) :: DFDU(NDIM,NDIM), DFDP(NDIM,*)
      F(1) = -U(2) - U(3)
      F(2) = U(1) + 0.2d0*U(2)
      F(3) = 0.2d0 + U(3)*(U(1) - PAR(1))
      IF (IJAC.EQ.0) RETURN
      DFDU(1:3,1:3) = 0d0
      DFDU(1,2) = -1d0
      DFDU(1,3) = -1d0
      DFDU(2,1) = 1d0
      DFDU(2,2) = 0.2d0
      DFDU(3,1) = U(3)
      DFDU(3,3) = U(1) - PAR(1)
      IF (IJAC.EQ.1) RETURN
      DFDP(1:3,1) = 0d0
      DFDP(3,1) = -U(3)
      END SUBROUTINE FUNC

      SUBROUTINE STPNT(NDIM,U,PAR,X)
      IMPLICIT NONE
      INTEGER, INTENT(IN) :: NDIM
      DOUBLE PRECISION, INTENT(INOUT) :: U(NDIM), PAR(*)
      DOUBLE PRECISION, INTENT(IN) :: X
      OPEN(UNIT=77, FILE='parameters.txt', STATUS='old')
      READ(77,*) PAR(1), PAR(11)
      CLOSE(77)
      END SUBROUTINE STPNT

      SUBROUTINE PVLS(NDIM,U,PAR)
      END SUBROUTINE PVLS

      SUBROUTINE BCND
      END SUBROUTINE BCND

      SUBROUTINE ICND
      END SUBROUTINE ICND

      SUBROUTINE FOPT
      END SUBROUTINE FOPT
